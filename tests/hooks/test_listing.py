from geoprior.hooks.listing import as_lines, as_tree


def test_every_kind_is_a_heading_and_every_name_a_line(fresh_plugins):
    lines = as_lines(fresh_plugins)
    headings = [line for line in lines if not line.startswith(" ")]
    kinds = {entry.spec.kind for entry in fresh_plugins.registered()}
    assert headings == sorted(headings)
    assert len(headings) == len(kinds)
    assert {"motions", "policies", "variants"} <= set(headings)
    for entry in fresh_plugins.registered():
        assert any(entry.spec.name in line.split() and entry.spec.summary in line for line in lines)


def test_variants_stand_under_their_heading(fresh_plugins):
    lines = as_lines(fresh_plugins)
    below = lines[lines.index("variants") + 1 :]
    assert [line.split()[0] for line in below[:2]] == ["black-images", "no-hand-cube"]


def test_the_tree_says_which_plug_in_offers_what(fresh_plugins):
    (plugin,) = (
        tree for tree in as_tree(fresh_plugins) if tree["name"] == "geoprior.render.variants.black_images"
    )
    assert plugin["hooks"] == ["geoprior_variants"]
    assert [(offer["kind"], offer["name"]) for offer in plugin["offers"]] == [("variant", "black-images")]
