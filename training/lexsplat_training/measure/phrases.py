"""Other ways to say the words of labelled frames. None is a word or a synonym in training."""

PHRASES = {
    "sofa": ["settee", "something soft to sit on with friends"],
    "bed": ["where one lies down at night", "mattress"],
    "chair": ["something to sit on", "seat"],
    "trash can": ["something to throw rubbish in", "waste basket"],
    "television": ["telly", "something to watch films on"],
    "tv screen": ["telly", "something to watch films on"],
    "curtain": ["drapes", "cloth in front of the window"],
    "refrigerator": ["fridge", "where the food is kept cold"],
    "wardrobe": ["closet", "where the clothes hang"],
    "nightstand": ["bedside table", "little cabinet next to the bed"],
    "desk": ["writing table", "where one works"],
    "air conditioner": ["ac unit", "something that cools the room"],
    "picture": ["painting", "something that decorates the wall"],
    "carpet": ["mat on the floor", "rug on the ground"],
    "window": ["where daylight comes in"],
    "door": ["where one leaves the room"],
    "lamp": ["light fixture", "something that gives light"],
    "mug": ["something to drink coffee from"],
    "book": ["something to read"],
    "potted plant": ["houseplant"],
}
