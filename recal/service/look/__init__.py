"""`look`: any log on one page. What it holds, how its sensors behave, what it can be used for."""
