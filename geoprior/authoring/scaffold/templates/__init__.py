"""What new packages begin as: one small working plug-in of each kind, and the files around it.

A folder is named after its kind and is a module that could be registered as it is; nobody does, so nothing of
it can be named in a config. `geoprior.authoring.scaffold.write` copies it under the new package's name.
"""
