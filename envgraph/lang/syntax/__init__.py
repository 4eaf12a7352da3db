"""Turn text into tokens and syntax trees with exact positions of all mistakes: the five languages, XML and TOML."""
