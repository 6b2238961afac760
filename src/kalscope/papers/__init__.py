"""The three source documents: their figures and tables, recomputed."""
