"""What the verbs read: runs, tables, twins, settings, from paths or records, given or looked up."""
