"""ABB RAPID (docs/languages/rapid.md): the grammar and the machine, of which the strict read-back uses the first."""
