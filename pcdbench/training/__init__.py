"""What learned completers share: the stream of training pairs, the loop, checkpoints that survive, curves."""
