"""Pictures, films and the page that shows them."""
