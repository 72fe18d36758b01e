"""The figures, by topic; each module has a table `PLOTS`."""
