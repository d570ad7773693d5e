"""Layers that torch's operators would compute in several passes over memory, each as one pass, on a CPU.

A training step on a CPU spends as long on passes over memory as on products. Each function here equals a few
operators of torch, in float32 arithmetic whatever the numbers are stored in, and says which. Elsewhere (on a
GPU, under torch.compile, in an export, in other types of numbers) those operators do the work.
"""
