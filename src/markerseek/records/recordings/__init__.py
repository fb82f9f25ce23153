"""Recordings of other people, as they come: tables, folders, arrays, single frames, Ultrasonix files."""
