"""Text to tokens and trees, with every mistake at its place: the five languages, XML and TOML."""
