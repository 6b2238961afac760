"""The source documents, recomputed."""
