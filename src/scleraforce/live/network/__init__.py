"""OpenIGTLink messages, a scanner's frames and the operator's reset."""
