"""What a model of relations can do."""
