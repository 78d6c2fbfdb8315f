"""Reference problem R1 in several programs, each solved in a process of its own."""
