"""A fleet: many recordings tuned on Dask, kept as durable parts, with one filter for all."""
