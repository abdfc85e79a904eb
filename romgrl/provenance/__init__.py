"""What a stage is made from: its key, the digest of its code, versions."""
