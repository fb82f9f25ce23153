"""Readers of files that may have been made to do harm: no crash, no hang, no more memory than the file is worth."""
