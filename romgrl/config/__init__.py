"""What a key may be: the schema, the values that fit it, addresses and overrides as text."""
