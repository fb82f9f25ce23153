"""Protocols and file headers as bytes, for drivers, emulators and records. Pure: no file is opened here."""
