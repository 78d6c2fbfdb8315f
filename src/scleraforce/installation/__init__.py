"""What an installation has, lacks and can do: `scleraforce doctor`."""
