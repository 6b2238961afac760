"""The spike-proof fit: q and r of a record without the samples that neither the past nor the future predicts."""
