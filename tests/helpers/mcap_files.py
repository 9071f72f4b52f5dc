"""Read MCAP files of JSON messages, each of which must be valid by the schema that the file holds."""

import io
import json

import jsonschema
from mcap.reader import make_reader


def read(data):
    """Topic to (time, message) of an MCAP file, each valid by its schema."""
    found = {}
    for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages():
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        rules = json.loads(schema.data)
        assert rules["title"] == schema.name
        jsonschema.Draft202012Validator.check_schema(rules)
        fields = json.loads(message.data)
        jsonschema.validate(fields, rules)
        assert fields.keys() <= rules["properties"].keys()
        assert message.log_time == message.publish_time
        if "timestamp" in fields:
            assert message.log_time == fields["timestamp"]["sec"] * 10**9 + fields["timestamp"]["nsec"]
        found.setdefault((channel.topic, schema.name), []).append((message.log_time, fields))
    for messages in found.values():
        times = [time for time, _ in messages]
        assert times == sorted(times)
    return found
