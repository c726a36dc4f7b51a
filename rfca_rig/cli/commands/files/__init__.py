"""Commands on files: `init`, `import` and `export`, both in `export`, `check`, `recover` and `schema`."""
