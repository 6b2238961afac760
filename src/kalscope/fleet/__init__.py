"""Many recordings of sensors of one kind, on all cores or a Dask cluster."""
