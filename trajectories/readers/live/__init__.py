"""Sources that are read while they grow: `rows` (what comes, and its order), `text_source` (run
directories, tables, standard input), `mavlink_source` (udp, tcp, serial line).
"""
