"""Layers that torch's operators would compute in several passes over memory, each as one pass, on a CPU.

A training step on a CPU spends as long on passes over memory, and on the calls that ask for them, as on
products. What stands here equals a few operators of torch, in float32 arithmetic whatever the numbers are
stored in, and says which. Elsewhere (on a GPU, under torch.compile, in an export, in other types of numbers)
those operators do the work.

For training: `products` and `tokens`, which `blocks` puts together into sublayers of a transformer; `maps`
for norms, ReLUs and pooling of feature maps. For predictions: `packed` products and convolutions, and `kept`,
which knows for how long they hold.
"""
