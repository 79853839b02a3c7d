"""Reads a recording with the MCAP project's own library, which shares nothing with lexsplat.

    recording.py FILE

Prints one line of JSON: the schema and the number of messages of each topic, the bytes at the
start of the first color image, and the first pose.
"""

import json
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def main() -> None:
    topics: dict[str, dict] = {}
    first: dict[str, object] = {}
    with open(sys.argv[1], "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, _, message in reader.iter_decoded_messages():
            topic = topics.setdefault(channel.topic, {"schema": schema.name, "messages": 0})
            topic["messages"] += 1
            first.setdefault(channel.topic, message)
    position = first["/camera/pose"].pose.position
    found = {
        "topics": topics,
        "color": first["/camera/color"].data[:3].hex(),
        "position": [position.x, position.y, position.z],
        "fx": first["/camera/calibration"].K[0],
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
