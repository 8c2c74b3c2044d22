"""What the elastic robot does when a motor file is played on it: errors, causes, sensitivities."""
