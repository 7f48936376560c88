"""From a question about a model to an answer. Pure: engines come in as functions."""
