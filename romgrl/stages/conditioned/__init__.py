"""What a student that follows commands has where a student of one speed has a reference."""
