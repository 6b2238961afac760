"""The answer for a fleet: one filter for all, what each device loses by it, and which are unlike the others."""
