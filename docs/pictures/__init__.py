"""Scripts that make the pictures of these pages, and the tables that show what a search found."""
