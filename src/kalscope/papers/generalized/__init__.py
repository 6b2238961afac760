"""The generalized filter of Khan et al.: its formulas over a record, and the compiled loops."""
