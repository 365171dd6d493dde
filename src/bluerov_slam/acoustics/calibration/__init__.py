"""What can be learnt about an array from its own data."""
