"""`kalscope filter`: a recording as a CSV, or lines of standard input one by one."""
