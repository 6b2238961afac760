"""What oscilloscopes write above, and beside, the samples of a trace."""
