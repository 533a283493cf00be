"""What commands show to a reader."""
