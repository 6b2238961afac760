"""Export: a tuning becomes files for a device; a recording becomes a filtered table or a report."""
