"""What an export holds beside the policy's graph."""
