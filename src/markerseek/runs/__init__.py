"""What happens on a rig over time: a search kept in a journal, a search resumed, a bank scanned, a journal recomputed.

`markerseek.rigs` puts a rig together; nothing there runs. The commands and the studies start here.
"""
