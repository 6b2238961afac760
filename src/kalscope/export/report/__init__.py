"""One page for the lab book: chart, parameters, numbers, verdicts and the command that reopens it all."""
