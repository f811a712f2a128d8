"""One module a verb: inputs to typed results. The command line, fleet and web call only this."""
