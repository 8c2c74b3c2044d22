"""A box as a STEP file (ISO 10303-21, AP214), written out by hand."""

from itertools import pairwise

import numpy as np


def step_box(size, unit=".MILLI."):
    lines = []

    def add(text):
        lines.append(f"#{len(lines) + 1}={text};")
        return f"#{len(lines)}"

    def point(p):
        return add("CARTESIAN_POINT('',({}))".format(",".join(f"{float(c):.6f}" for c in p)))

    def direction(d):
        return add("DIRECTION('',({}))".format(",".join(f"{float(c):.6f}" for c in d)))

    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * np.asarray(size, float)
    vertex = [add(f"VERTEX_POINT('',{point(c)})") for c in corners]
    edges = {}

    def oriented(a, b):
        key = (min(a, b), max(a, b))
        if key not in edges:
            way = corners[key[1]] - corners[key[0]]
            vector = add(f"VECTOR('',{direction(way / np.linalg.norm(way))},1.)")
            line = add(f"LINE('',{point(corners[key[0]])},{vector})")
            edges[key] = add(f"EDGE_CURVE('',{vertex[key[0]]},{vertex[key[1]]},{line},.T.)")
        return add(f"ORIENTED_EDGE('',*,*,{edges[key]},.{'T' if key == (a, b) else 'F'}.)")

    faces = []
    for ring in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)):
        sides = ",".join(oriented(a, b) for a, b in pairwise((*ring, ring[0])))
        loop = add(f"EDGE_LOOP('',({sides}))")
        x = corners[ring[1]] - corners[ring[0]]
        normal = np.cross(x, corners[ring[2]] - corners[ring[1]])
        axes = (point(corners[ring[0]]), direction(normal / np.linalg.norm(normal)), direction(x / np.linalg.norm(x)))
        place = add("AXIS2_PLACEMENT_3D(''," + ",".join(axes) + ")")
        plane = add(f"PLANE('',{place})")
        bound = add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        faces.append(add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = add(f"MANIFOLD_SOLID_BREP('',{shell})")
    length = add(f"(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT({unit},.METRE.))")
    angle = add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")
    solid_angle = add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())")
    unsure = add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-7),{length},'distance_accuracy_value','')")
    context = add(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({unsure})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle})) REPRESENTATION_CONTEXT('',''))"
    )
    axes = (point((0, 0, 0)), direction((0, 0, 1)), direction((1, 0, 0)))
    origin = add("AXIS2_PLACEMENT_3D(''," + ",".join(axes) + ")")
    shape = add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({origin},{solid}),{context})")
    application = add("APPLICATION_CONTEXT('automotive design')")
    add(f"APPLICATION_PROTOCOL_DEFINITION('','automotive_design',2000,{application})")
    market = add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
    product = add(f"PRODUCT('box','box','',({market}))")
    version = add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    stage = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
    defined = add(f"PRODUCT_DEFINITION('design','',{version},{stage})")
    whole = add(f"PRODUCT_DEFINITION_SHAPE('','',{defined})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({whole},{shape})")
    head = "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('box','',(''),(''),'','','');\n"
    body = "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n" + "\n".join(lines)
    return head + body + "\nENDSEC;\nEND-ISO-10303-21;\n"
