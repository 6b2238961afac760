"""A second process for long work on files: it can be ended at any moment, and it never blocks this one."""
