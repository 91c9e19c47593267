"""Turn fitted bodies into the result that the user gets."""
