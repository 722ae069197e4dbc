"""The shared store: what is put there can be loaded elsewhere, each array once, and is gone at the end."""

import gc
import pickle

import numpy as np

from grainmotion.cluster.shared_store import MIN_FILE_BYTES, SharedStore

BIG = np.arange(MIN_FILE_BYTES, dtype=np.float32).reshape(-1, 8)


def files(shelf):
    return sorted(p.name for p in shelf.folder.iterdir())


def test_round_trip(tmp_path):
    shelf = SharedStore(tmp_path)
    stored = pickle.loads(pickle.dumps(shelf.put({"big": BIG, "small": np.arange(3), "text": "x"})))
    assert len(stored.pickled) < 1000
    taken = stored.load()
    np.testing.assert_array_equal(taken["big"], BIG)
    np.testing.assert_array_equal(taken["small"], np.arange(3))
    assert taken["text"] == "x"
    taken["big"][:] = 0  # whoever takes it may use it
    np.testing.assert_array_equal(stored.load()["big"], BIG)


def test_an_array_is_written_once(tmp_path):
    shelf = SharedStore(tmp_path)
    shelf.put([BIG, BIG])
    shelf.put({"again": BIG})
    assert len(files(shelf)) == 1
    shelf.put(BIG.copy())
    assert len(files(shelf)) == 2


def test_another_array_at_the_same_place_is_another(tmp_path):
    shelf = SharedStore(tmp_path)
    for value in range(20):  # freed memory is used again, and so are identities
        array = np.full(MIN_FILE_BYTES, value)
        np.testing.assert_array_equal(shelf.put(array).load(), array)
        del array


def test_arrays_end_to_end_are_one_file(tmp_path):
    shelf, laid = SharedStore(tmp_path), np.arange(2 * MIN_FILE_BYTES)
    parts = [laid[:MIN_FILE_BYTES].reshape(-1, 8), laid[MIN_FILE_BYTES:]]
    taken = shelf.put(parts).load()
    for one, other in zip(taken, parts, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(files(shelf)) == 1
    assert taken[0].base is taken[1].base


def test_a_view_as_another_type_stays_one(tmp_path):
    laid = np.arange(2.0 * MIN_FILE_BYTES)
    view = laid.view(np.uint32)[MIN_FILE_BYTES:]
    taken = SharedStore(tmp_path).put(view).load()
    assert taken.dtype == np.uint32
    np.testing.assert_array_equal(taken, view)


def test_kept_for_its_owner(tmp_path):
    shelf = SharedStore(tmp_path)
    kept = shelf.store_images(BIG[None])
    assert len(files(shelf)) == 1
    np.testing.assert_array_equal(kept.rows(0, len(BIG))[0], BIG)
    del kept
    gc.collect()
    assert files(shelf) == []


def test_lent_for_a_moment(tmp_path):
    shelf, images = SharedStore(tmp_path), np.random.default_rng(0).normal(size=(3, 10, 4))
    with shelf.temporary((images,)) as (temporary,):
        np.testing.assert_array_equal(temporary.rows(2, 5), images[:, 2:5])
        np.testing.assert_array_equal(temporary.all(), images)
    assert files(shelf) == []


def test_nothing_is_left(tmp_path):
    (tmp_path / "results").mkdir()
    for folder in (tmp_path / "results", tmp_path / "new"):
        shelf = SharedStore(folder)
        shelf.put(BIG)
        shelf.close()
    assert (tmp_path / "results").is_dir()
    assert not list((tmp_path / "results").iterdir())
    assert not (tmp_path / "new").exists()
