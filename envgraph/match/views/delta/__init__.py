"""Delta functions: generated code that updates a view after one tuple has been inserted or deleted."""
