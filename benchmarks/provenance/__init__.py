"""Where the figures of a page are from: the line that says so, and whether today's code would still make them."""
