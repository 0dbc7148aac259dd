"""Starting the nodes, watching them walk, ending them."""
