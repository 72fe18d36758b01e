"""Tables of columns as files hold them, one module per format: no record yet, any names."""
