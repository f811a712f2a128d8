"""The import path of users' own effects, `simreal.effects.own`; the list itself is `ins.errors`."""
