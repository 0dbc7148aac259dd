"""What commands share: options from typed models, exit codes, executables by name, a place in a running graph."""
