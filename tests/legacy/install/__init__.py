"""`ludus addon install --legacy` in projects written for another add-on."""
