"""What classes inherit, where there are few of them and where there are many."""

from random import Random
from time import process_time

import pytest

from envgraph.graph import Model, check_conformance
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar


def lattice(count: int, seed: int) -> Metamodel:
    """Classes that extend up to three of those before them; some are abstract, some have features."""
    random = Random(seed)
    classes = []
    for number in range(count):
        above = random.sample(range(number), min(number, random.choice([0, 1, 1, 2, 3])))
        features = (
            Attribute(f"a{number}", Scalar.INT),
            Reference(f"r{number}", f"C{random.randrange(count)}", lower=0, upper=None),
        )
        classes.append(
            Class(
                f"C{number}",
                supertypes=tuple(f"C{one}" for one in above),
                features=features if number % 3 else (),
                abstract=number % 5 == 4,
            )
        )
    return Metamodel("m", classes)


def supertypes_of(metamodel: Metamodel, name: str) -> set[str]:
    """A class and its supertypes, as the definition says."""
    direct = metamodel.classes[name].supertypes
    return {name}.union(*(supertypes_of(metamodel, one) for one in direct))


@pytest.mark.parametrize("count", [1, 30, 300])
def test_subclasses_features_and_overlaps_are_those_of_the_definition(count: int) -> None:
    metamodel = lattice(count, seed=count)
    table = {name: supertypes_of(metamodel, name) for name in metamodel.classes}
    concrete = {name for name, cls in metamodel.classes.items() if not cls.abstract}
    below = {name: {one for one in table if name in table[one]} for name in table}
    for name, expected in table.items():
        assert {one for one in table if metamodel.is_a(name, one)} == expected
        assert set(metamodel.concrete_classes(name)) == below[name] & concrete
        kinds = [
            cls.name for cls, kind in zip(metamodel.class_list, metamodel.instance_flags(name), strict=False) if kind
        ]
        assert set(kinds) == below[name]
        assert metamodel.instance_flags(name)[-1] == 0
        owners = {feature.owner for feature in metamodel.features(name).values()}
        assert owners == {one for one in expected if metamodel.classes[one].features}
        for other in list(table)[::7]:
            assert metamodel.may_overlap(name, other) == bool(below[name] & below[other] & concrete)


@pytest.mark.parametrize("count", [30, 300])
def test_objects_of_classes_with_many_supertypes_are_created_linked_and_deleted(count: int) -> None:
    metamodel = lattice(count, seed=1)
    model = Model(metamodel)
    made = {model.create(cls.name).id: cls.name for cls in metamodel.class_list if not cls.abstract}
    reference = next(
        one
        for one in metamodel.references
        if metamodel.concrete_classes(one.owner) and metamodel.concrete_classes(one.target)
    )
    source, target = model.graph.extent(reference.owner)[0], model.graph.extent(reference.target)[-1]
    model.graph.link(source, reference, target)
    assert list(model.graph.targets(source, reference)) == [target]
    model.check_integrity()
    model.graph.delete(source, semantics="spo")
    assert not model.graph.alive(source)
    del made[source]
    for name in metamodel.classes:
        assert sorted(model.graph.extent(name)) == [node for node, cls in made.items() if metamodel.is_a(cls, name)]
    model.check_integrity()


@pytest.mark.parametrize("kind", ["nothing", "attributes", "references"])
def test_a_chain_of_thousands_of_superclasses_is_soon_ready(kind: str) -> None:
    def features(number: int) -> tuple[Attribute | Reference, ...]:
        if kind == "attributes":
            return (Attribute(f"a{number}", Scalar.INT),)
        return (Reference(f"r{number}", f"C{number}", lower=0, upper=None),) if kind == "references" else ()

    count = 3_000
    classes = [
        Class(f"C{number}", supertypes=(f"C{number - 1}",) if number else (), features=features(number))
        for number in range(count)
    ]
    started = process_time()
    model = Model(Metamodel("m", classes))
    first, last = model.create("C0").id, model.create(f"C{count - 1}").id
    assert check_conformance(model) == []
    assert list(model.graph.extent("C0")) == [first, last]
    assert list(model.graph.extent(f"C{count - 1}")) == [last]
    assert process_time() - started < 10, "it takes a fraction of a second; the square of it took minutes"
