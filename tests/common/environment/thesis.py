"""The experiments 2 and 3 of the thesis: its Tables 4.3 and 4.7, as an environment's file holds them."""

DAILY = {"periods_hours": [24.0], "weights": [1.0], "phases": [0.0], "trend_per_hour": 0.0}

EXPERIMENT_2 = [
    ("map1", "A", "C", "2023-05-07 17:08:32", 18.723),
    ("map2", "C", "D", "2023-05-07 17:10:49", 13.598),
    ("map3", "D", "E", "2023-05-07 17:23:01", 19.345),
    ("map4", "E", "B", "2023-05-07 17:24:36", 24.703),
    ("map5", "B", "G", "2023-05-07 17:26:09", 26.871),
    ("map6", "E", "F", "2023-05-07 21:02:47", 13.331),
    ("map7", "F", "G", "2023-05-07 21:04:21", 20.298),
    ("map8", "A", "B", "2023-05-07 21:07:37", 18.001),
    ("map9", "A", "D", "2023-05-07 21:09:25", 26.146),
]
EXPERIMENT_3 = [
    ("map1", "S", "G", "2023-05-07 18:04:03", 100.392),
    ("map2", "S", "G", "2023-05-07 18:09:54", 69.692),
    ("map3", "S", "G", "2023-05-07 21:18:07", 44.469),
]


def environment(maps, model=None, name="campus"):
    """The content of an environment's file; ``maps`` are rows of name, start, end, time, metres and, if any, n."""
    keys = ("name", "start", "end", "timestamp", "length", "generation")
    return {"name": name, "model": model or DAILY, "maps": [dict(zip(keys, row, strict=False)) for row in maps]}
