"""A mechanism, an encoder, a reasoner, an agent and an object for busybot, the smallest of each kind."""
