"""Format texts in one style: tokens and comments stay the same, only blanks and line breaks change."""
