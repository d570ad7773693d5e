"""Plans synthetic episodes and makes shards of them: the only room that knows both scenes and shards."""
