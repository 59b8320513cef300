"""Languages of controllers: the engine, and a folder for each language."""
