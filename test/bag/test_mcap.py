"""Bags are read by the MCAP project's own reader."""

from __future__ import annotations

import numpy as np
import pytest

from imotor_ros.contracts import topics

reader = pytest.importorskip("mcap.reader", reason="needs the package mcap")
decoder = pytest.importorskip("mcap_ros2.decoder", reason="needs the package mcap-ros2-support")


@pytest.mark.parametrize("is_compressed", [True, False])
@pytest.mark.parametrize("kind", ["SeekingReader", "NonSeekingReader"])
def test_official_reader_decodes_every_message(stand_run, tmp_path, kind, is_compressed):
    run = stand_run(blocks=8, size=2000)
    run.write(tmp_path / "bag", is_compressed=is_compressed)
    found = {topic.name: 0 for topic in topics.ALL_TOPICS}
    samples = []
    with (tmp_path / "bag" / "bag.mcap").open("rb") as stream:
        opened = getattr(reader, kind)(
            stream, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()]
        )
        for _, channel, message, content in opened.iter_decoded_messages():
            name = channel.topic.removeprefix("/stand/")
            found[name] += 1
            assert message.log_time == message.publish_time
            if name == "rod/velocity":
                samples.append(content.samples)
                assert content.header.frame_id == name
    assert found == {
        topic.name: sum(m.topic == topic.name for m in run.in_order())
        for topic in topics.ALL_TOPICS
    }
    assert np.array_equal(np.concatenate(samples), run.samples("rod/velocity"))


def test_official_reader_finds_profile_statistics_and_metadata(stand_run, tmp_path):
    run = stand_run()
    run.write(tmp_path / "bag")
    with (tmp_path / "bag" / "bag.mcap").open("rb") as stream:
        opened = reader.make_reader(stream)
        assert opened.get_header().profile == "ros2"
        summary = opened.get_summary()
        assert summary.statistics.message_count == len(run.in_order())
        assert summary.statistics.channel_count == len(topics.ALL_TOPICS)
        assert [record.name for record in opened.iter_metadata()] == ["rosbag2"]
        qos = {c.topic: c.metadata["offered_qos_profiles"] for c in summary.channels.values()}
    assert "keep_all" in qos["/stand/rod/velocity"]
    assert "transient_local" in qos["/stand/channels"]
