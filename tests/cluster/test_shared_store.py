"""`SharedStore`: round trips, each array in one file, and no files left at the end."""

import gc
import pickle

import numpy as np

from grainmotion.cluster.shared_store import MIN_FILE_BYTES, SharedStore

LARGE = np.arange(MIN_FILE_BYTES, dtype=np.float32).reshape(-1, 8)


def files(store):
    return sorted(p.name for p in store.folder.iterdir())


def test_round_trip(tmp_path):
    store = SharedStore(tmp_path)
    stored = pickle.loads(pickle.dumps(store.put({"big": LARGE, "small": np.arange(3), "text": "x"})))
    assert len(stored.pickled) < 1000
    loaded = stored.load()
    np.testing.assert_array_equal(loaded["big"], LARGE)
    np.testing.assert_array_equal(loaded["small"], np.arange(3))
    assert loaded["text"] == "x"
    loaded["big"][:] = 0  # loaded arrays are the caller's own copies
    np.testing.assert_array_equal(stored.load()["big"], LARGE)


def test_same_array_is_written_once(tmp_path):
    store = SharedStore(tmp_path)
    store.put([LARGE, LARGE])
    store.put({"again": LARGE})
    assert len(files(store)) == 1
    store.put(LARGE.copy())
    assert len(files(store)) == 2


def test_new_array_at_a_freed_address_is_stored_anew(tmp_path):
    store = SharedStore(tmp_path)
    for value in range(20):  # Python reuses addresses and ids of freed arrays
        array = np.full(MIN_FILE_BYTES, value)
        np.testing.assert_array_equal(store.put(array).load(), array)
        del array


def test_contiguous_parts_of_one_array_share_a_file(tmp_path):
    store, contiguous = SharedStore(tmp_path), np.arange(2 * MIN_FILE_BYTES)
    parts = [contiguous[:MIN_FILE_BYTES].reshape(-1, 8), contiguous[MIN_FILE_BYTES:]]
    loaded = store.put(parts).load()
    for one, other in zip(loaded, parts, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(files(store)) == 1
    assert loaded[0].base is loaded[1].base


def test_view_keeps_its_dtype(tmp_path):
    contiguous = np.arange(2.0 * MIN_FILE_BYTES)
    view = contiguous.view(np.uint32)[MIN_FILE_BYTES:]
    loaded = SharedStore(tmp_path).put(view).load()
    assert loaded.dtype == np.uint32
    np.testing.assert_array_equal(loaded, view)


def test_stored_images_are_deleted_with_their_owner(tmp_path):
    store = SharedStore(tmp_path)
    images = store.store_images(LARGE[None])
    assert len(files(store)) == 1
    np.testing.assert_array_equal(images.rows(0, len(LARGE))[0], LARGE)
    del images
    gc.collect()
    assert files(store) == []


def test_temporary_images_are_deleted_after_use(tmp_path):
    store, images = SharedStore(tmp_path), np.random.default_rng(0).normal(size=(3, 10, 4))
    with store.temporary((images,)) as (temporary,):
        np.testing.assert_array_equal(temporary.rows(2, 5), images[:, 2:5])
        np.testing.assert_array_equal(temporary.all(), images)
    assert files(store) == []


def test_a_store_within_takes_files_that_are_kept(tmp_path):
    store, array = SharedStore(tmp_path), LARGE.copy()
    kept = store.keep(array)
    assert store.keep(array) == kept
    inner = store.within()
    stored = pickle.loads(pickle.dumps(inner.put({"kept": array, "other": LARGE})))
    assert len(files(inner)) == 1, "the kept array is not written again"
    loaded = stored.load()
    np.testing.assert_array_equal(loaded["kept"], array)
    np.testing.assert_array_equal(loaded["other"], LARGE)
    inner.close()
    np.testing.assert_array_equal(kept.all(), array)
    assert len(files(store)) == 1
    store.put(array)
    assert len(files(store)) == 2, "what is put here may outlive the array"
    store.close()


def test_kept_arrays_are_deleted_with_the_arrays(tmp_path):
    store, array = SharedStore(tmp_path), LARGE.copy()
    store.keep(array)
    del array
    gc.collect()
    assert files(store) == []
    inner = store.within()
    for value in range(20):  # whose ids may be those of the array that is gone
        np.testing.assert_array_equal(inner.put(np.full(LARGE.shape, value)).load(), value)


def test_close_removes_all_files(tmp_path):
    (tmp_path / "results").mkdir()
    for folder in (tmp_path / "results", tmp_path / "new"):
        store = SharedStore(folder)
        store.put(LARGE)
        store.close()
    assert (tmp_path / "results").is_dir()
    assert not list((tmp_path / "results").iterdir())
    assert not (tmp_path / "new").exists()
