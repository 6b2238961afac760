"""Does the filter fit the record, and would another one be better?"""
