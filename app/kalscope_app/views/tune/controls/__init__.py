"""The controls of single parameters: a text box with the exact value, and a slider."""
