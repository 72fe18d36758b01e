"""What commands share: options, names known without imports, signs of life, ends, tables."""
