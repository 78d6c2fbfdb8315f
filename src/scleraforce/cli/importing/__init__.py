"""What `scleraforce import` asks, works out and tells."""
