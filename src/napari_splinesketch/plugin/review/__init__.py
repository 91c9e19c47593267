"""Looking through the curves: table, plots, proof."""
