"""Models as JSON and XMI, and to and from networkx."""
