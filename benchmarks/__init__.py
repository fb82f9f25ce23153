"""Times of the kernels, each in turn with those of other people's programs. Run by ``make bench``.

Nothing here is a test, and nothing is asserted about time. Before two programs are timed, their outputs are compared;
how far they differ stands in the table.
"""
