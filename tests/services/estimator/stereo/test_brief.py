import cv2
import numpy as np

from services.estimator.stereo import brief


def test_hamming_equals_counting_the_bits():
    rng = np.random.default_rng(0)
    descriptors = rng.integers(0, 256, (40, brief.BYTES), dtype=np.uint8)
    words = brief.as_words(descriptors)
    for a in range(0, 40, 3):
        for b in range(40):
            assert brief.hamming(words[a], words[b]) == np.unpackbits(descriptors[a] ^ descriptors[b]).sum()


def test_each_bit_compares_its_pair_of_pixels():
    image = np.random.default_rng(1).integers(0, 256, (60, 60), dtype=np.uint8)
    bits = np.unpackbits(brief.describe(image, np.array([[30, 25]], np.int32))[0], bitorder="little")
    x1, y1, x2, y2 = brief.PATTERN.T.astype(int)
    np.testing.assert_array_equal(bits, image[25 + y1, 30 + x1] < image[25 + y2, 30 + x2])


def test_a_descriptor_survives_a_change_of_light_and_tells_places_apart():
    noise = np.random.default_rng(2).integers(0, 256, (200, 200), dtype=np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 3.0)
    darker = (image * 0.6 + 20).astype(np.uint8)
    places = np.random.default_rng(3).integers(20, 180, (50, 2)).astype(np.int32)
    before, after = (brief.as_words(brief.describe(i, places)) for i in (image, darker))
    same = [brief.hamming(before[i], after[i]) for i in range(50)]
    other = [brief.hamming(before[i], before[(i + 1) % 50]) for i in range(50)]
    assert np.median(same) < 15
    assert np.median(other) > 90
