"""Files of others: Ecore, XMI, JSON, pyecore; and traces."""
