"""The real devices, one vendor one file. Nothing is imported here: each file is loaded when its device is used."""
