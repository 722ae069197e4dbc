"""Members of a team run the same code on shares of the grains, and find what one process finds, to the bit."""

import socket
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

from few_grains import grain_set, radiographs, small_motions
from grainmotion.cluster.connection import ComputeConfig, connect
from grainmotion.cluster.team import SECONDS_TO_MEET, Team, listen, sent_by_teams
from grainmotion.cluster.team_backend import TeamBackend
from grainmotion.cluster.team_tracking import TeamState
from grainmotion.model.compact_volume import CompactVolume
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_matrix
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_in_place, project_in_place
from grainmotion.tracking.track import TrackSettings, track_with_residual

distributed = pytest.importorskip("distributed")
cloudpickle = pytest.importorskip("cloudpickle")

QUICK = TrackSettings(search=False, fields=False)
SHARED_FROM = 2


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Two worker processes; Dask starts another one for one that dies."""
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local,
        connect(ComputeConfig(local.scheduler_address), tmp_path_factory.mktemp("store")) as connection,
    ):
        connection.executor.client.wait_for_workers(2, timeout=900)
        yield connection
    cloudpickle.unregister_pickle_by_value(sys.modules[__name__])


def sample():
    """Five grains in single precision, with finer voxels kept compactly."""

    def single(volume):
        return replace(volume, array=volume.array.astype(np.float32))

    grains = (replace(g, volume=single(g.volume), fine=CompactVolume.of(single(g.fine))) for g in grain_set().grains)
    return GrainSet(tuple(grains))


def operations(grains, scan, backend=None):
    """The results of all operations on patches, by the CPU or by a team."""
    arrays = GrainArrays.of(grains, fine=True)
    arrays = arrays if backend is None else arrays.on(backend)
    pose = Pose(np.zeros((5, 3)), np.tile(np.eye(3), (5, 1, 1)))
    patches = footprint_patches(arrays, pose, scan.geometry, margin=2)
    rng = np.random.default_rng(0)
    factor, image = rng.random((2, *scan.line_integrals.shape), np.float32)
    x = rng.random((6 * len(grains), 3))
    values, jacobian = differentiate_in_place(arrays, pose, scan.geometry, patches, "trilinear")
    jacobian.filter(factor, np.array([0.6, 0.2], np.float32))
    return {
        "values": np.asarray(values),
        "again": np.asarray(project_in_place(arrays, pose, scan.geometry, patches, "trilinear")),
        "radiographs": assemble(values, patches, scan.geometry, arrays.backend),
        "derivatives": np.asarray(jacobian.copy().derivatives),
        "gradient": jacobian.gradient(image),
        "images": np.stack(jacobian.images(x.T.reshape(3, len(grains), 6))),
        "products": PatchNormalMatrix(jacobian) @ x,
        "own blocks": PatchNormalMatrix(jacobian).blocks(),
        "all blocks": normal_matrix(jacobian).toarray(),
    }


def by_a_member(rank, places, token, grains, scan):
    """`operations` by a member of a team, and a loop of independent calls."""
    team = Team.meet(rank, places, token)
    try:
        before = sent_by_teams()
        found = operations(grains, scan, TeamBackend(team, SHARED_FROM))
        assert sent_by_teams() > before
        return found, team.call_each(lambda k: (k, rank), [1, 2, 3])
    finally:
        team.close()


def place(token):
    return listen("127.0.0.1", token)


def test_all_operations_give_the_bits_of_one_process(cluster):
    client, grains = cluster.executor.client, sample()
    scan = radiographs(grains, small_motions(grains))
    addresses = cluster.executor.workers()
    places = client.gather([client.submit(place, "token", workers=[a], pure=False) for a in addresses])
    members = [
        client.submit(by_a_member, rank, places, "token", grains, scan, workers=[a], pure=False)
        for rank, a in enumerate(addresses)
    ]
    expected = operations(grains, scan)
    for found, calls in client.gather(members):
        for name, array in expected.items():
            np.testing.assert_array_equal(found[name], array, err_msg=name)
        assert calls == [(1, 0), (2, 1), (3, 0)]


def test_a_state_tracked_together_has_the_bits_of_one_process_also_after_a_worker_is_lost(cluster):
    grains = sample()
    scan = radiographs(grains, small_motions(grains))
    motions, residual = track_with_residual(grains, scan, (None,), QUICK)
    messages, client = [], cluster.executor.client
    first = cluster.executor.workers()[1]

    def lose_one(message, done, total):
        messages.append(message)
        if len(messages) == 1:
            threading.Thread(target=client.retire_workers, args=([first],), kwargs={"close_workers": True}).start()

    for progress in (None, lose_one):
        state = TeamState("one", scan, "reference", (None,), QUICK, SHARED_FROM)
        found, left = cluster.track_together(grains, state, progress)
        np.testing.assert_array_equal(found.translations, motions.translations)
        np.testing.assert_array_equal(found.rotations, motions.rotations)
        np.testing.assert_array_equal(found.covariances, motions.covariances)
        np.testing.assert_array_equal(left, residual)
    assert messages


def test_a_stranger_is_not_let_in():
    """A member waits for those that know the token, and gives up after a while."""
    place = listen("127.0.0.1", "secret")
    found = []
    waiting = threading.Thread(target=lambda: found.append(Team.meet(0, [place, place], "secret")))
    waiting.start()
    with socket.create_connection(place) as stranger:
        stranger.sendall(b"x" * (len("secret") + 8))
        assert stranger.recv(1) == b""
    with socket.create_connection(place) as known:
        known.sendall(b"secret" + (1).to_bytes(8, "big"))
        waiting.join(SECONDS_TO_MEET)
        assert list(found[0].others) == [1]
        found[0].close()
