from jcontour.geometry.gcode.flow import structure

MANY = 20_000


def test_many_subprograms_that_never_end():
    """Each is faulty by the next one; those beyond the depth by that."""
    found = structure([f"o{k} sub" for k in range(MANY)])
    assert found.faults[0] == "subprogram o1 begins inside o0"
    assert found.faults[MANY - 1] == f"o{MANY - 1} sub is more than 200 deep"
    assert len(found.faults) == MANY


def test_many_branches_end_in_any_order():
    """Those inside one that ends first have no end; ends without a beginning are faulty, too."""
    found = structure([f"o{k} if [1]" for k in range(MANY)] + ["o9 endif"] * MANY)
    assert found.ending == {9: MANY, MANY: MANY}
    assert set(found.faults) == set(range(MANY)) - {9} | set(range(MANY + 1, 2 * MANY))
    assert found.faults[MANY + 1] == "o9 endif without o9 if"


def test_a_subprogram_does_not_see_the_branches_around_it():
    found = structure(["o1 if [1]", "o2 sub", "o1 endif", "o2 endsub", "o1 endif"])
    assert found.faults == {2: "o1 endif without o1 if"}
    assert found.ending == {0: 4, 4: 4}
