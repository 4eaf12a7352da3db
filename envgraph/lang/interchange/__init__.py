"""Read and convert files of other tools (Ecore, XMI, JSON, pyecore, levels), and read traces."""
