"""The preview as a page: what is shown as a value (``view``), and the page made of it (``html``)."""
