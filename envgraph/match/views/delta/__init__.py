"""Delta functions: the source that updates a view after the change of one tuple."""
