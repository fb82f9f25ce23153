"""B-mode scans of an independent make, and how well the tip of an instrument is found in them."""
