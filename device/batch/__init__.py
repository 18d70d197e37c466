"""Archives: a folder of inspection videos and recordings becomes maps, exchange files and one summary."""
