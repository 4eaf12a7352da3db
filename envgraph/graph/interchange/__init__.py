"""Write models as JSON and XMI, read JSON, and convert to and from networkx."""
