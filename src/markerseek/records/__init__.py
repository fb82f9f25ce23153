"""What was seen, on disk: frame files, banks and their replay, and the result of a search."""
