"""What a policy sees and when."""
