"""The paper's method, as the paper has it."""
