"""What the documentation shows of the code, one module a kind of part."""
