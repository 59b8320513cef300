"""ABB RAPID (docs/languages/rapid.md). The read-back of a post is in `strict`."""
