"""`recal twin`: one module a command, `app` the group."""
