"""What a run was worth: records, metrics against ground truth, tables, figures, run directories."""
